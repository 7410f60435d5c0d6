"""Controller programs as filters: targets are found in the text, corrected, and only their
numbers are rewritten.
"""
