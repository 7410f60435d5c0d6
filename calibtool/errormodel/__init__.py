"""Families of errors, one file each: effect, identification, storage, simulation and text."""
