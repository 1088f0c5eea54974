"""What is asked for, and how, checked before any work."""
