"""Requested against achieved accuracy, scene by scene: `python -m bench.accuracy -o FOLDER`."""
