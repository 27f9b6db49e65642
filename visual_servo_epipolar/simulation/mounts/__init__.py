"""Camera rigs: which camera a robot carries and where, behind one Protocol; its sensor."""
