"""The loops of `vrte._core` for OpenCL: *.cl as package data, and what runs them. Arrays in, arrays out."""
