"""Models that predict walks from the walks simulated so far."""
