"""The model: a scene of parts, their shapes and surfaces, and what is known of them without a session."""
