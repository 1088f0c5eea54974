"""What a laboratory reads off a panel: instrument geometries, colour, hiding, gloss, Kubelka and Munk's numbers."""
