"""What light meets, and the light that comes in."""
