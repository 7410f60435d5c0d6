"""Planning: which configurations to measure, under what conditions, in which order; poses of an
acceptance test.
"""
