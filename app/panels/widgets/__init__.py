"""Building blocks of all panels: theme, fonts, icons, number fields, and drags that become one step."""
