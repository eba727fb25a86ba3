"""What two touching surfaces can mean to each other, and the motion that meaning leaves."""
