#include "apps/job/schema/block_fields.hpp"

#include <cmath>

#include "apps/job/schema/job_schema.hpp"

namespace orbid::apps::describe {

namespace {

// More than anybody waits for; keeps a slip of the pen from filling memory.
constexpr double most_starts = 100000;
constexpr double most_draws = 1e7;
constexpr double most_chains = 1000;
// Only guards the conversion to int.
constexpr double most_iterations = 1e4;
// Beyond any picture and any memory; the limits only keep numbers in their types.
constexpr double most_branch_points = 1e6;
constexpr double most_branches = 1e4;

const std::vector<std::string> switch_names{"period_doubling", "symmetry_breaking"};

void read_switch(ObjectReader& object, periodic::ContinuationOptions& options) {
    const auto value = object.find("switch");
    if (!value) return;
    options.switch_doublings = options.switch_symmetry = false;
    for (const ValueReader& item : value->items()) {
        const auto choice = item.choice(switch_names);
        if (choice) (*choice == 0 ? options.switch_doublings : options.switch_symmetry) = true;
    }
}

void write_switch(const periodic::ContinuationOptions& options, nlohmann::ordered_json& object) {
    object["switch"] = nlohmann::ordered_json::array();
    if (options.switch_doublings) object["switch"].push_back(switch_names[0]);
    if (options.switch_symmetry) object["switch"].push_back(switch_names[1]);
}

/// A number of a density.
template <class Density>
Field<Density> density_number(const char* name, const ValueSchema& value, double Density::*member) {
    return open_field(key(name, value, "A number of the density.").required_always(), member);
}

}  // namespace

const FieldTable<SampleJob>& sample_fields() {
    static const FieldTable<SampleJob> table{
        open_field(key("draws", whole(0, most_draws), "Per chain, after the warm-up.").required_always(),
                   &SampleJob::draws),
        field(key("chains", whole(2, most_chains), "Their agreement is the test."), &SampleJob::chains),
        field(key("warm_up", whole(1, most_draws), "Draws that tune the sampler."), &SampleJob::warm_up)};
    return table;
}

const FieldTable<MultiStartJob>& multi_start_fields() {
    static const FieldTable<MultiStartJob> table{
        field(key("starts", whole(1, most_starts), "The job's and random ones."), &MultiStartJob::starts),
        open_field(key("seed", seed(), "Of the random starts; the job's unless given."), &MultiStartJob::seed)};
    return table;
}

const FieldTable<SimulationJob>& samples_fields() {
    static const FieldTable<SimulationJob> table{
        open_field(key("step", above(0.0), "Between two samples.").in("s").required_always(), &SimulationJob::step),
        open_field(
            key("count", whole(2, most_simulated_points), "Number of samples of a trajectory.").required_always(),
            &SimulationJob::count)};
    return table;
}

const FieldTable<ColumnJob>& column_fields() {
    static const FieldTable<ColumnJob> table{
        open_field(key("column", header(), "Its header in the file.").required_always(), &ColumnJob::column),
        open_field(key("unit", text(), "Of the column; the coordinate's own unless given."), &ColumnJob::unit),
        field(key("sign", one_of({1.0, -1.0}), "Model value = sign * (column * unit - offset)."), &ColumnJob::sign),
        field(key("offset", number(), "In the coordinate's unit."), &ColumnJob::offset)};
    return table;
}

const FieldTable<models::EquationText::Parameter>& equation_parameter_fields() {
    using Parameter = models::EquationText::Parameter;
    static const FieldTable<Parameter> table = [] {
        FieldTable<Parameter> fields{
            open_field(key("value", number(), "Its value.").required_always(), &Parameter::value),
            field(key("unit", text(), "Its unit."), &Parameter::unit),
            choice_field("domain", domain_names, "The values that it can have.", &Parameter::domain),
            open_field(key("typical", above(0.0), "Its typical size; that of its value unless given."),
                       &Parameter::typical),
            field(key("description", text(), "What it is."), &Parameter::description)};
        fields.back().write = [](const Parameter& parameter, nlohmann::ordered_json& object) {
            if (!parameter.description.empty()) object["description"] = parameter.description;
        };
        return fields;
    }();
    return table;
}

const FieldTable<periodic::ShootingOptions>& solver_fields() {
    using Solver = periodic::ShootingOptions;
    static const FieldTable<Solver> table = [] {
        FieldTable<Solver> fields{
            field(key("tolerance", above(0.0), "Of the closing error, relative to the scales."), &Solver::tolerance),
            field(key("maximum_iterations", whole(1, most_iterations), "Newton steps."), &Solver::maximum_iterations),
            open_field(key("maximum_distance", above(0.0),
                           "An orbit farther from its start than this, relative to the scales, counts as another one; "
                           "any unless given."),
                       &Solver::maximum_distance)};
        fields.back().write = [](const Solver& solver, nlohmann::ordered_json& object) {
            if (std::isfinite(solver.maximum_distance)) object["maximum_distance"] = solver.maximum_distance;
        };
        return fields;
    }();
    return table;
}

const FieldTable<periodic::ContinuationOptions>& step_fields() {
    using Options = periodic::ContinuationOptions;
    static const FieldTable<Options> table{
        field(key("first", above(0.0), "First step along the branch."), &Options::first_step),
        field(key("smallest", above(0.0), "The branch ends below it."), &Options::smallest_step),
        field(key("largest", above(0.0), "Largest step along the branch."), &Options::largest_step)};
    return table;
}

const FieldTable<periodic::ContinuationOptions>& branch_fields() {
    using Options = periodic::ContinuationOptions;
    static const FieldTable<Options> table{
        field(key("points", whole(2, most_branch_points), "Per branch, at most."), &Options::maximum_points),
        field(key("branches", whole(1, most_branches), "At most."), &Options::maximum_branches),
        {key("switch", set(choice(switch_names)), "Bifurcations at which the branch that begins there is followed.")
             .standard_text(R"(["period_doubling", "symmetry_breaking"])"),
         read_switch, write_switch},
        field(key("maximum_period", whole(1, longest_computed_period), "No branch of a longer period is followed."),
              &Options::maximum_period),
        field(key("maximum_time", above(0.0), "Autonomous models: an orbit longer than this ends the branch.").in("s"),
              &Options::longest)};
    return table;
}

const DensityForms& density_forms() {
    using namespace estimator;
    const ValueSchema any = number();
    const ValueSchema positive = above(0.0);
    static const DensityForms forms{
        {"normal",
         "Normal.",
         {1.0, 1.0},
         {density_number("mean", any, &NormalPrior::mean), density_number("sd", positive, &NormalPrior::sd)}},
        {"lognormal",
         "The logarithm is normal.",
         {1.0, 1.0},
         {density_number("median", positive, &LogNormalPrior::median),
          density_number("log_sd", positive, &LogNormalPrior::log_sd)}},
        {"uniform",
         "The same everywhere between two numbers.",
         {1.0, 1.0},
         {density_number("lower", any, &UniformPrior::lower), density_number("upper", any, &UniformPrior::upper)}},
        {"half_normal",
         "The positive half of a normal density about 0.",
         {1.0},
         {density_number("scale", positive, &HalfNormalPrior::scale)}},
        {"half_cauchy",
         "The positive half of a Cauchy density about 0.",
         {1.0},
         {density_number("scale", positive, &HalfCauchyPrior::scale)}},
        {"gamma",
         "Gamma.",
         {1.0, 1.0},
         {density_number("shape", positive, &GammaPrior::shape), density_number("rate", positive, &GammaPrior::rate)}},
        {"student_t",
         "Student's t.",
         {1.0, 1.0, 1.0},
         {density_number("dof", positive, &StudentPrior::dof), density_number("location", any, &StudentPrior::location),
          density_number("scale", positive, &StudentPrior::scale)}}};
    return forms;
}

}  // namespace orbid::apps::describe
