"""What a user hands over: callbacks with their checks, quantities and events."""
