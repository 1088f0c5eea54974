"""What goes in and out as files: scene TOML in, NetCDF and CSV out."""
