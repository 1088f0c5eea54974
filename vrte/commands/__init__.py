"""The commands of `vrte`, listed in parser.py; the module of each has ``add``, its arguments, and ``run``."""
