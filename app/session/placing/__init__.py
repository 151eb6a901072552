"""What is said and done after things were put somewhere."""
