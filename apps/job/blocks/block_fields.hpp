#pragma once

#include "apps/job/blocks/field_kinds.hpp"
#include "models/equations/equation_text.hpp"
#include "periodic/search/orbit_search.hpp"

namespace orbid::apps {

struct SimulationJob;
struct FileJob;
struct ColumnJob;
struct OrbitStart;
struct ContinuationJob;

}  // namespace orbid::apps

namespace orbid::apps::describe {

// The tables of blocks; schema, reader and writer walk over them.

/// An experiment.
[[nodiscard]] const FieldTable<DataJob>& data_fields();
/// "simulate", read after "file", beside which it is refused.
[[nodiscard]] Field<DataJob> simulation_field();
/// The noise has an entry per coordinate even if the job is invalid.
[[nodiscard]] SimulationJob simulation_without_noise(const Job& job);
/// "file" and what is said of it, "inputs" and "interpolation".
void add_file_fields(FieldTable<DataJob>& table);
/// Which part of a file is read: "window", "rows", "every", "spacing".
[[nodiscard]] const FieldTable<FileJob>& record_part_fields();
/// "stream" of a recorded file.
[[nodiscard]] Field<FileJob> stream_field();
/// One column of a table: "theta", or { "column": "theta", "unit": "deg", "factor": 2, "sign": -1, "offset": 3.14 }.
[[nodiscard]] const FieldTable<ColumnJob>& column_fields();
[[nodiscard]] ValueSchema column();
/// @param unit  of the quantity, in which the column is unless it says another.
[[nodiscard]] ColumnJob read_column(const ValueReader& value, Eigen::Index index, std::string_view unit);
/// The columns that orbid writes, for a table of which "columns" says nothing.
void take_default_columns(const Job& job, FileJob& file);
[[nodiscard]] Field<DataJob> sensor_field();
/// "initial_state"; DataJob::initial_state has an entry per coordinate before.
[[nodiscard]] Field<DataJob> initial_state_field();
/// What is known of a parameter of equations in the job.
[[nodiscard]] const FieldTable<models::EquationText::Parameter>& equation_parameter_fields();
[[nodiscard]] const FieldTable<OrbitsJob>& orbits_fields();
/// "embedding" of orbits.
[[nodiscard]] Field<OrbitsJob> embedding_field();
/// Reports what vectors of delays have no use for.
/// @param alone  `data` is a record of samples of an autonomous model, of which one coordinate is observed.
void check_embedding(ObjectReader& object, const Job& job, const DataJob& data, bool alone, const OrbitsJob& orbits);
[[nodiscard]] const FieldTable<PeriodicJob>& periodic_fields();
/// A start of "orbits" of periodic.
[[nodiscard]] const FieldTable<OrbitStart>& orbit_start_fields();
[[nodiscard]] OrbitStart read_orbit_start(const ValueReader& value, const Job& job);
/// "search" of periodic.
[[nodiscard]] const FieldTable<periodic::OrbitSearchOptions>& orbit_search_fields();
void read_orbit_search(const ValueReader& value, const Job& job, PeriodicJob& periodic);
/// "continuation" of periodic, read after the starts.
[[nodiscard]] const FieldTable<ContinuationJob>& continuation_fields();
void read_continuation(const ValueReader& value, const Job& job, PeriodicJob& periodic);
[[nodiscard]] const FieldTable<EstimateJob>& estimate_fields();

}  // namespace orbid::apps::describe
