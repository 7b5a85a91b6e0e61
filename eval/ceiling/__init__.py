"""What physics allows at least: searches for actions that answer the pushes which policies lose."""
