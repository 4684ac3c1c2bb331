"""From logs to a project: fields surveyed and mapped, vehicle and campaign drafted, trials written."""

from __future__ import annotations
