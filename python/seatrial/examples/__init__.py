"""Examples that ship with the package: campaigns, missions, recipes (`seatrial new`), the gallery of the paper."""
