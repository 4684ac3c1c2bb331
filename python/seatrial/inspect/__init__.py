"""What a log can tell: consistency, manoeuvres, kind of data, feedback, waves, wiring, verdict per axis."""

from __future__ import annotations
