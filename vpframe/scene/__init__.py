"""The model: a scene of parts with their shapes and surfaces."""
