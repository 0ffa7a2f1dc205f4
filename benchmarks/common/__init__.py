"""What all measurements share: their files, and the page that shows them."""
