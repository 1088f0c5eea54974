"""Who is answered, for how much, and how the server begins and ends."""
