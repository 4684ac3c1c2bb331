"""How sure an identification is: standard deviations, what the data tell, and what they cannot.

`assessment` puts it together; `uncertainty` stands on `whitened` and `residual_blocks`; `identifiability` on
`information`, `weak_combination` and `manoeuvre_advice`.
"""
