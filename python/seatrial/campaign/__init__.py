"""The campaign file, its parameters, its trials and its variants."""
