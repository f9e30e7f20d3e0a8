"""A scene held against what is right: error against cost, and the mathematics at the state that it reaches."""
