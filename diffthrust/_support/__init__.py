"""What every folder may use and none is about: errors, words, files, tables, figures."""
