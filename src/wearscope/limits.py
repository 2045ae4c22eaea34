"""How large an input may be that comes from someone else; each sentence that refuses one names the limit."""

#: Largest YAML file [bytes], most values in it, deepest nesting, longest number [characters].
YAML_BYTES, YAML_VALUES, YAML_DEPTH, NUMBER_LENGTH = 2_000_000, 120_000, 40, 40
#: Largest JSON file that is shown or read as a verdict [bytes], and its deepest nesting.
JSON_BYTES, JSON_DEPTH = 30_000_000, 100
#: Largest text file of another kind, such as a URDF [bytes]; most links and joints of a URDF.
TEXT_BYTES, LINKS = 20_000_000, 5000
#: Largest recording as it lies on disk and in memory [bytes]; most columns of a table.
TABLE_BYTES, UNPACKED_BYTES, COLUMNS = 500_000_000, 800_000_000, 2000
#: Largest memory that reading one recording may take, largest description in a Parquet file [bytes].
READING_BYTES, FOOTER_BYTES = 1_500_000_000, 10_000_000
#: Largest number of joints of a data set or robot; of runs of a data set; of entries of its other lists.
JOINTS, RUNS, ENTRIES = 40, 2000, 2000
#: Largest number of entries of a list in a configuration; largest whole number; longest text.
LIST, COUNT, TEXT = 10_000, 1_000_000_000, 4000
#: Largest number of a machine; the product of a few numbers of this size is still finite.
NUMBER = 1e30
#: Heaviest payload or link [kg], longest distance in a payload [m].
MASS, LENGTH = 1e6, 1e3
#: Lowest rate of a recording [Hz], below which nothing of a motion is seen.
SLOWEST = 1.0
#: Largest gear ratio, inertia of a rotor at its joint [kg m^2], and torque of a joint [N m].
GEAR_RATIO, INERTIA, TORQUE = 1e6, 1e6, 1e9
#: The three limits before, by the name of the field.
DRIVE = {"gear_ratio": GEAR_RATIO, "rotor_inertia": INERTIA, "torque_limit": TORQUE}
#: Largest number of samples of a planned motion, times its joints: two hours of a joint at 1 kHz.
SAMPLES = 20_000_000
#: Longest name of a robot, data set, link or joint, and of a column of a recording that is converted.
NAME, COLUMN = 100, 300
#: Largest header of a member of an archive [bytes], such as a long name.
TAR_HEADER_BYTES = 1_000_000
#: Largest manifest of an archive, and largest archive as its manifest says [bytes]; longest path in one.
MANIFEST_BYTES, ARCHIVE_BYTES, PATH = 50_000_000, 1 << 40, 1000
#: Longest first line of a CSV file [bytes].
HEADER_LINE = 100_000
#: Longest text of a table's value as it is shown; most problems that a check lists.
CELL, PROBLEMS = 1000, 200
#: A setting is named that would take longer [s] or more room [bytes]: a year, a terabyte.
YEAR, TERABYTE = 365.25 * 86400.0, 1e12
