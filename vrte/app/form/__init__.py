"""The scene as a form: what is typed, what the library says to it, how it comes from files and links."""
