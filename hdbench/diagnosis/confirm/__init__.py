"""What was named held against samples and conditions that its fit has not seen."""
