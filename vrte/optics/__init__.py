"""Particles in, phase matrices out."""
