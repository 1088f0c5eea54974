"""The viewer: a local web page, and the figures that it shows."""
