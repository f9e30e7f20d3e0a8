"""What a run keeps of itself, and what can be done with it afterwards."""
