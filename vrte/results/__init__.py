"""What comes back: plain data."""
