#include <algorithm>
#include <stdexcept>
#include <tuple>
#include <type_traits>
#include <variant>

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using estimator::JointNormalPrior;

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

template <class Density>
Field<Density> density_number(const char* name, const ValueSchema& value, double Density::*member) {
    return open_field(key(name, value, "A number of the density.").required_always(), member);
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

/// The density of this form, where it is there.
template <class Density>
void read_density(ObjectReader& object, const DensityForm<Density>& form, std::optional<estimator::Prior>& prior) {
    const auto value = object.find(form.name);
    if (!value) return;
    Density density = form.unset;
    read_object(*value, form.fields, density);
    if constexpr (std::is_same_v<Density, estimator::UniformPrior>) {
        if (value->sound() && !(density.lower < density.upper))
            value->report(fmt::format("lower {} must be below upper {}", density.lower, density.upper));
    }
    prior = density;
}

const FieldTable<JointNormalPrior>& joint_normal_fields() {
    static const FieldTable<JointNormalPrior> table{
        {key("names", list(text()), "Estimated parameters.").required_always(),
         [](const ValueReader& value, const Job&, JointNormalPrior& prior) {
             for (const auto& [name, item] : read_names(value))
                 prior.names.push_back(name);
         },
         [](const JointNormalPrior& prior, const Writing&) -> Json { return prior.names; }},
        {key("mean", list(number()), "One number per name.").required_always(),
         [](const ValueReader& value, const Job&, JointNormalPrior& prior) {
             const auto count = static_cast<Eigen::Index>(prior.names.size());
             prior.mean = read_numbers(value);
             if (value.is(JsonValue::Kind::array) && prior.mean.size() != count)
                 value.report(fmt::format("must hold one number per name: {}, not {}", count, prior.mean.size()));
         },
         [](const JointNormalPrior& prior, const Writing&) { return json_list(prior.mean); }},
        {key("covariance", matrix(), "Symmetric and positive definite, one row per name.").required_always(),
         [](const ValueReader& value, const Job&, JointNormalPrior& prior) {
             const auto count = static_cast<Eigen::Index>(prior.names.size());
             if (const auto read = read_matrix(value, count)) prior.covariance = *read;
         },
         [](const JointNormalPrior& prior, const Writing&) { return json_rows(prior.covariance); }}};
    return table;
}

/// Names of estimated parameters without another prior; `taken` are those of the joint priors before.
void check_joint_names(const ValueReader& names, const Job& job, const EstimateJob& estimate,
                       std::vector<std::string>& taken) {
    const auto known = estimated_parameter_names(job, estimate.parameters);
    for (const auto& entry : read_names(names)) {
        const std::string& name = entry.first;
        const ValueReader& item = entry.second;
        if (job.model.system && !is_in(name, known)) {
            item.report(fmt::format("\"{}\" is no estimated parameter{}", name, suggestion(name, known)));
        } else if (is_in(name, taken)) {
            item.report(fmt::format("\"{}\" stands in a joint prior already", name));
        }
        taken.push_back(name);
        for (const FreeParameterJob& free : estimate.parameters) {
            if (free.value.name != name.substr(0, name.find('@'))) continue;
            if (!free.value.tied_to.empty()) {
                item.report(fmt::format("{} is tied to {}: name that one", name, free.value.tied_to));
            } else if (!std::holds_alternative<estimator::FlatPrior>(free.value.prior)) {
                item.report(fmt::format("{} has a prior of its own in \"parameters\"", name));
            }
        }
    }
}

void read_joint_normal(const ValueReader& value, const Job& job, EstimateJob& estimate,
                       std::vector<std::string>& taken) {
    const std::size_t problems_before = value.problem_count();
    const auto names = ObjectReader(value).find("names");
    if (!names) return;
    JointNormalPrior prior;
    read_object(value, joint_normal_fields(), prior, job);
    check_joint_names(*names, job, estimate, taken);
    // What is wrong already would only be reported a second time in other words.
    if (!value.sound() || value.problem_count() != problems_before) return;
    try {
        estimator::validate(prior);
        estimate.joint_priors.push_back(std::move(prior));
    } catch (const std::invalid_argument& error) {
        value.report(error.what());
    }
}

}  // namespace

ValueSchema prior() {
    std::vector<KeySchema> keys;
    std::vector<std::string> forms;
    const auto add = [&](const auto& form) {
        keys.push_back(key(form.name, object(keys_of(form.fields)), form.text));
        forms.push_back(form.name);
    };
    std::apply([&](const auto&... form) { (add(form), ...); }, density_forms());
    return named("prior", choice({"flat"}) | object(keys, forms));
}

std::optional<estimator::Prior> read_prior(const ValueReader& value) {
    if (value.is(JsonValue::Kind::string)) {
        if (!value.choice({"flat"})) return std::nullopt;
        return estimator::FlatPrior{};
    }
    ObjectReader object(value);
    std::optional<estimator::Prior> prior;
    std::apply([&](const auto&... form) { (read_density(object, form, prior), ...); }, density_forms());
    object.finish();
    return prior;
}

Json prior_document(const estimator::Prior& prior) {
    return std::visit(
        []<class Density>(const Density& density) -> Json {
            if constexpr (std::is_same_v<Density, estimator::FlatPrior>) {
                return "flat";
            } else {
                const auto& form = std::get<DensityForm<Density>>(density_forms());
                return {{form.name, fields_document(density, form.fields)}};
            }
        },
        prior);
}

std::vector<std::string> estimated_parameter_names(const Job& job, const std::vector<FreeParameterJob>& parameters) {
    std::vector<std::string> names;
    for (const FreeParameterJob& free : parameters) {
        const auto has_own = [&](const DataJob& data) { return data.has_own(free.parameter); };
        for (const DataJob& data : job.data)
            if (has_own(data)) names.push_back(free.value.name + "@" + data.name);
        const bool shared = job.data.empty() || !std::all_of(job.data.begin(), job.data.end(), has_own);
        if (shared) names.push_back(free.value.name);
    }
    return names;
}

Field<EstimateJob> joint_priors_field() {
    const auto joint =
        object({key("normal", object(keys_of(joint_normal_fields())), "Several parameters are normal together.")
                    .required_always()});
    return {key("joint_priors", list(joint), "Priors of several parameters together.").standard_text("[]"),
            [](const ValueReader& value, const Job& job, EstimateJob& estimate) {
                std::vector<std::string> taken;
                for (const ValueReader& item : value.items()) {
                    ObjectReader entry(item);
                    if (const auto normal = entry.find("normal")) read_joint_normal(*normal, job, estimate, taken);
                    entry.finish();
                }
            },
            [](const EstimateJob& estimate, const Writing& at) {
                return json_list(estimate.joint_priors, [&](const JointNormalPrior& prior) -> Json {
                    return {{"normal", fields_document(prior, joint_normal_fields(), at)}};
                });
            }};
}

}  // namespace orbid::apps::describe
