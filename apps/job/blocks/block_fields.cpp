#include "apps/job/blocks/block_fields.hpp"

#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/estimate_job.hpp"

namespace orbid::apps::describe {

namespace {

// More than anybody waits for; keeps a slip of the pen from filling memory.
constexpr double most_starts = 100000;
constexpr double most_draws = 1e7;
constexpr double most_chains = 1000;
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

const FieldTable<models::EquationText::Parameter>& equation_parameter_fields() {
    using Parameter = models::EquationText::Parameter;
    static const FieldTable<Parameter> table{
        open_field(key("value", number(), "Its value.").required_always(), &Parameter::value),
        field(key("unit", text(), "Its unit."), &Parameter::unit),
        choice_field(key("domain", {}, "The values that it can have."), domain_names, &Parameter::domain),
        open_field(key("typical", above(0.0), "Its typical size; that of its value unless given."),
                   &Parameter::typical),
        text_field(key("description", text(), "What it is.").by_default(""), &Parameter::description)};
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
