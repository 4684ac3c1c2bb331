"""Examples that ship with the package: campaigns, missions and recipes (`seatrial new`), and the gallery of the paper."""
