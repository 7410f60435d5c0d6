"""Planning: configurations to measure, constraints, visiting order, and poses of an acceptance
test.
"""
