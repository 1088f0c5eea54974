"""Requested against achieved accuracy, scene by scene: `python -m vrte.studies.accuracy -o FOLDER`."""
