"""Correction of controller programs: targets are found in the text, corrected, and only their
numbers are rewritten.
"""
