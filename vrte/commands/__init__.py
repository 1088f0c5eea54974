"""The commands of `vrte`, listed in commands.toml; the module of each has ``add``, its arguments, and ``run``."""
