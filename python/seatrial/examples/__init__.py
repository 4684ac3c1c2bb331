"""Examples that ship with the package: campaigns, missions and recipes."""
