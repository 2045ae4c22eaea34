rule report:
    input:
        f"{R}/scope.parquet",
