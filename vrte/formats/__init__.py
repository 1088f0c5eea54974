"""What goes in and out as files: scene TOML in; NetCDF, CSV and Mitsuba's tensor file out."""

from vrte.formats.result_file import load, save

__all__ = ["load", "save"]
