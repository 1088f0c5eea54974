"""Error against run time of every method, scene by scene: `vrte report -o FOLDER`."""
