"""A page with the lobes of a table to turn around: one file that needs no network and no server."""
