"""The demonstration: a twin that holds an effect which its data set does not declare."""
