"""The commands of `vrte`, listed in commands.toml; the module of each has ``run``, and ``check`` before it."""
