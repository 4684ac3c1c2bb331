"""Verification of an autopilot: requirements on missions, and how sure it is that they are kept.

A `requirement` says of every mission whether it held and how far it was from its threshold
(`expression` reads it); `failure_probability` says what the share of failures tells of the next missions;
`causes` says which random input drives them; `junit` writes the verdicts for a build server.
"""
