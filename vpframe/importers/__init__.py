"""Files in, scenes out. This module stays light: the reading process imports it too."""
