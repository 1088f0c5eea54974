"""Spheres with a computed BRDF under a polarized sky, and pictures of them."""
