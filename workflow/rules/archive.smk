rule archive:
    input:
        f"results/archive/{STUDY.study}.tar",


rule pack_archive:
    input:
        study=rules.report.input,
        own=FILES.own_files(),
        code=lambda w: code("pack_archive"),
    output:
        f"results/archive/{STUDY.study}.tar",
    log:
        f"{R}/logs/pack_archive.log",
    conda:
        ENV
    params:
        config=config,
    message:
        "Pack the study into {output}"
    script:
        "../scripts/pack_archive.py"
