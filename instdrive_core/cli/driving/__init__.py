"""Options about the ways of vehicles."""
