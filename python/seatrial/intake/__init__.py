"""What a log needs before it is a trial: whether its channels tell one motion, and what to correct."""

from __future__ import annotations
