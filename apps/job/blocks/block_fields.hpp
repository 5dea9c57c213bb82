#pragma once

#include <string>
#include <tuple>

#include "apps/job/blocks/field_table.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "models/equations/equation_text.hpp"

namespace orbid::apps::describe {

// The tables of blocks; schema, reader and writer walk over them.

[[nodiscard]] const FieldTable<SampleJob>& sample_fields();
[[nodiscard]] const FieldTable<MultiStartJob>& multi_start_fields();
/// "samples" of a simulation.
[[nodiscard]] const FieldTable<SimulationJob>& samples_fields();
[[nodiscard]] const FieldTable<ColumnJob>& column_fields();
/// What is known of a parameter of equations in the job.
[[nodiscard]] const FieldTable<models::EquationText::Parameter>& equation_parameter_fields();
[[nodiscard]] const FieldTable<OrbitsJob>& orbits_fields();
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

/// A form of prior density.
template <class Density>
struct DensityForm {
    std::string name;
    std::string text;
    Density unset;  ///< every density allows these numbers: for those that are refused
    FieldTable<Density> fields;
};

/// All but the flat one.
using DensityForms = std::tuple<DensityForm<estimator::NormalPrior>, DensityForm<estimator::LogNormalPrior>,
                                DensityForm<estimator::UniformPrior>, DensityForm<estimator::HalfNormalPrior>,
                                DensityForm<estimator::HalfCauchyPrior>, DensityForm<estimator::GammaPrior>,
                                DensityForm<estimator::StudentPrior>>;
[[nodiscard]] const DensityForms& density_forms();

}  // namespace orbid::apps::describe
