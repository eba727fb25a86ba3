"""What two surfaces can mean to each other: the table of pairings, candidates, fits."""
