"""What the report says about the figures: content without form."""
