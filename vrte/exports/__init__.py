"""Files for renderers: BRDFs tabulated for their formats or fitted by their models, and how far these are off."""
