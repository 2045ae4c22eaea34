"""What an archive of a study holds, and how it is read without trust; `wearscope.archive` is its command."""
