"""What goes in and out as files: scene TOML in, NetCDF and CSV out."""

from vrte.formats.netcdf import load

__all__ = ["load"]
