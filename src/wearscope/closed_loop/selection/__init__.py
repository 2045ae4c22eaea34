"""Which effects the model lacks: evidence, the rule, the search."""
