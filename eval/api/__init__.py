"""What a user of the package calls: policies by name, file or object in, results out."""
