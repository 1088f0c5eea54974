"""What the page shows: the form on the left, the result on the right, and what connects them."""
