"""Correction of controller programs: only the numbers of their targets are rewritten."""
