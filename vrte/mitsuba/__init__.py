"""Importing this registers the BSDF `vrte` with Mitsuba 3, in the variant that is set and in those that will be."""

from vrte.mitsuba.bsdf import mi, register, register_again

__all__ = ["register"]

if mi.variant():
    register()
mi.detail.add_variant_callback(register_again)
