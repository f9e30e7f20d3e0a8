"""A step in time: integrators propose it, step control accepts it or tries a smaller one, the ledger adds up its energy."""
