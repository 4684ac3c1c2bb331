"""A run as one HTML file that needs nothing else: written by `page`, read back by `embedded`."""
