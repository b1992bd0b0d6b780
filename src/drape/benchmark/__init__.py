"""What things cost and how accurate they are: each member measures one thing, in one run on one machine."""
