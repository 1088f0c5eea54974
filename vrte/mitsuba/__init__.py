"""Importing this registers the BSDF `vrte` with Mitsuba 3, in the variant that is set and in those that will be."""

from vrte.basics.llvm import prepare_llvm

prepare_llvm()

from vrte.mitsuba.bsdf import mi, register, register_again  # noqa: E402  # Mitsuba reads which LLVM to take

__all__ = ["register"]

if mi.variant():
    register()
mi.detail.add_variant_callback(register_again)
