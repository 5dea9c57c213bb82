#pragma once

#include <string>
#include <tuple>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/job/schema/field_table.hpp"
#include "models/equations/equation_text.hpp"

namespace orbid::apps::describe {

// The parts of a job that are flat: schema, reader and writer walk over these tables.

[[nodiscard]] const FieldTable<SampleJob>& sample_fields();
[[nodiscard]] const FieldTable<MultiStartJob>& multi_start_fields();
/// "samples" of a simulation.
[[nodiscard]] const FieldTable<SimulationJob>& samples_fields();
[[nodiscard]] const FieldTable<ColumnJob>& column_fields();
/// What is known of a parameter of equations in the job.
[[nodiscard]] const FieldTable<models::EquationText::Parameter>& equation_parameter_fields();
/// What all ways to solve for an orbit share.
[[nodiscard]] const FieldTable<periodic::ShootingOptions>& solver_fields();
/// "step" of a continuation.
[[nodiscard]] const FieldTable<periodic::ContinuationOptions>& step_fields();
/// How far a continuation goes.
[[nodiscard]] const FieldTable<periodic::ContinuationOptions>& branch_fields();

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
