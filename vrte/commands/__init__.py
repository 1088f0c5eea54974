"""The commands of `vrte`, one a file: ``add`` makes its part of the parser, and sets what runs."""
