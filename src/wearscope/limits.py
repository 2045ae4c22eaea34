"""Limits for input from unknown sources; each message that refuses such input states the limit."""

#: YAML file: largest size [bytes], number of values and depth, longest number [characters].
YAML_BYTES, YAML_VALUES, YAML_DEPTH, NUMBER_LENGTH = 2_000_000, 120_000, 40, 40
#: JSON file: largest size [bytes] and depth.
JSON_BYTES, JSON_DEPTH = 30_000_000, 100
#: Largest other text file, such as a URDF [bytes]; largest number of links and of joints in a URDF.
TEXT_BYTES, LINKS = 20_000_000, 5000
#: Largest recording on disk and in memory [bytes]; largest number of columns.
TABLE_BYTES, UNPACKED_BYTES, COLUMNS = 500_000_000, 800_000_000, 2000
#: Largest memory for reading one recording [bytes]; largest footer of a Parquet file [bytes].
READING_BYTES, FOOTER_BYTES = 1_500_000_000, 10_000_000
#: Largest number of joints of a data set or robot, of runs of a data set, of entries in its other lists.
JOINTS, RUNS, ENTRIES = 40, 2000, 2000
#: Configuration: longest list, largest whole number, longest text [characters].
LIST, COUNT, TEXT = 10_000, 1_000_000_000, 4000
#: Largest number in a machine's description; the product of a few such numbers is still finite.
NUMBER = 1e30
#: Largest mass of a payload or link [kg], largest distance in a payload [m].
MASS, LENGTH = 1e6, 1e3
#: Lowest sample rate of a recording [Hz]; a lower one cannot show a robot's motion.
SLOWEST = 1.0
#: Largest gear ratio, rotor inertia reflected to the joint [kg m^2], and joint torque [N m].
GEAR_RATIO, INERTIA, TORQUE = 1e6, 1e6, 1e9
#: The same three limits, by the name of the field in a model.
DRIVE = {"gear_ratio": GEAR_RATIO, "rotor_inertia": INERTIA, "torque_limit": TORQUE}
#: Largest number of samples of a planned motion times its joints; about an hour of six joints at 1 kHz.
SAMPLES = 20_000_000
#: Longest name of a robot, data set, link or joint, and of a column of a recording that is converted.
NAME, COLUMN = 100, 300
#: Largest header of an archive's member [bytes]; a long file name makes a header long.
TAR_HEADER_BYTES = 1_000_000
#: Archive: largest manifest [bytes], largest sum of file sizes [bytes], longest path [bytes].
MANIFEST_BYTES, ARCHIVE_BYTES, PATH = 50_000_000, 1 << 40, 1000
#: Longest first line of a CSV file [bytes].
HEADER_LINE = 100_000
#: Longest text shown in a table's cell [characters]; largest number of problems that a check lists.
CELL, PROBLEMS = 1000, 200
#: ``wearscope check`` reports a study's setting that would take more than a year [s] or a terabyte [bytes].
YEAR, TERABYTE = 365.25 * 86400.0, 1e12
