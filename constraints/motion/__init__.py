"""The nearest allowed motion among solid bodies."""
