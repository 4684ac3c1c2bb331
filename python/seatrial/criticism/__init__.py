"""What the residuals say against a model: memory, missing terms, signals that they follow.

`criticise` puts it together; `following` frees a suggested coefficient and compares the hold-out score.
"""
