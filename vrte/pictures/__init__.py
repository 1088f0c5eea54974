"""Results, scenes and plans as pictures, and as a notebook shows them."""
