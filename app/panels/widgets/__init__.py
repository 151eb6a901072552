"""What all panels build on: theme, fonts, icons, number fields, drags that are one step."""
