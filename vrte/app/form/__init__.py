"""The scene as a form: its fields, the library's checks of them, and its reading from files and links."""
