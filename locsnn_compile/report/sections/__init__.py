"""What the report says of the figures: content without form."""
