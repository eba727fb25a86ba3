"""Time stepping: free flight, impacts, kinematic bodies, sleep."""
