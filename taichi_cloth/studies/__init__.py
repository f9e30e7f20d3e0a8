"""A scene held against references: error against cost, and the mathematics at the state that it reaches."""
