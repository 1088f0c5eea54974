"""Error against run time of every method, scene by scene: `python -m bench.report -o FOLDER`."""
