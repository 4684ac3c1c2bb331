"""Examples that ship with the package: campaigns, missions and recipes, and the gallery of the paper."""
