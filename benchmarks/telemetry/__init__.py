"""The benchmark of the telemetry check."""
