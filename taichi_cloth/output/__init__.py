"""Pictures, telemetry, manifests: they take arrays and know nothing of the solver."""
