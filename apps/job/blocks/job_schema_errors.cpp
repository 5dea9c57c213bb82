#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/estimate_job.hpp"
#include "estimator/interface/residual.hpp"

namespace orbid::apps::describe {

namespace {

ValueSchema sd() {
    KeySchema estimated = number_or_estimate(above(0.0)).object->keys.front();
    estimated.required = false;  // or a column
    return named("sd",
                 above(0.0) | choice({"estimate"}) |
                     object({estimated, key("column", header(), "Header of a column of sds in the table of the data."),
                             key("factor", number_or_estimate(above(0.0)), "On the sds of that column.")
                                 .by_default(1)
                                 .with("column")},
                            {"estimate", "column"}));
}

ValueSchema error() {
    return named(
        "error",
        object(
            {key("distribution", choice(distribution_names), "Of a reading about its prediction.").by_default("normal"),
             key("dof", number_or_estimate(at_least(1.0)), "Degrees of freedom of Student's t.")
                 .by_default(estimator::StudentErrors{}.dof.value)
                 .with("distribution", {"student_t"}),
             key("relative", number_or_estimate(above(0.0)), "Share of the prediction that is added to the sd.")
                 .by_default("estimate")
                 .with("distribution", {"relative"}),
             key("correlation", number_or_estimate(between(-1.0, 1.0)), "Of one reading with the next.")
                 .by_default("estimate")
                 .with("distribution", {"ar1"}),
             key("sd", sd(),
                 "Standard deviation or scale; with weights \"covariance\" a factor on the covariance of the analysis.")
                 .by_default("estimate"),
             key("floor", at_least(0.0), "Least value that an estimated sd may take.").by_default(0.0)}));
}

ValueSchema ln_multiplier() {
    return object({key("distribution", choice({"normal"}), "Of ln|multiplier|.").by_default("normal"),
                   key("sd", number_or_estimate(above(0.0)), "As of a coordinate.").by_default("estimate")});
}

ValueSchema covariance() {
    const ValueSchema wishart =
        object({key("dof", above(0.0), "Degrees of freedom: above the number of responses less one.").required_always(),
                key("matrix", matrix(), "One row per response; symmetric and positive definite.").required_always()});
    return named(
        "covariance",
        names(2) |
            object({key("of", names(2), "The coordinates, two or more.").required_always(),
                    key("prior",
                        object({key("inverse_wishart", wishart, "The density of a covariance.").required_always()}),
                        "What is known of the covariance.")}));
}

ValueSchema errors() {
    return entries(error(), "an observed coordinate",
                   {key("covariance", covariance(), "Coordinates whose errors have one full covariance."),
                    key("ln_multiplier", ln_multiplier(), "Errors of ln|multiplier| of cycles.")});
}

/// One value for all experiments, or one per experiment.
ValueSchema per_experiment(const ValueSchema& value) {
    return value | entries(value, "an experiment");
}

ValueSchema matching() {
    return choice({"exact", "auto"}) |
           object({key("sd", choice({"estimate"}) | above_up_to(0.0, 1.0), "As a share of each coordinate's range.")
                       .required_always()});
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

ValueSchema number_or_estimate(const ValueSchema& number) {
    const ValueSchema inner = object({key("start", number, "Where the estimate begins."),
                                      key("prior", prior(), "What is known of it.").by_default("flat")});
    return number | choice({"estimate"}) |
           object({key("estimate", inner, "Estimated, with more said of it.").required_always()});
}

ValueSchema residual() {
    const std::vector<std::string> cycles{"cycles"};
    const std::vector<std::string> series{"series"};
    const std::vector<std::string> waveform{"waveform"};
    // Longer than any record; keeps a slip of the pen from overflowing.
    constexpr double longest_interval = 1e9;
    return named(
        "residual",
        object(
            {key("type", choice(residual_type_names),
                 "What is compared: points of cycles, a recorded series, or measured periodic steady states.")
                 .required_always(),
             key("data", names(1),
                 "Experiments that belong to it; unless given those with samples, else with sections.")
                 .with("type", {"series", "waveform"}),
             key("periods", periods(), "Periods of the cycles that are used; unless given all that are searched for.")
                 .with("type", cycles),
             key("weights", choice({"covariance", "equal"}),
                 "Covariance of the cycles from the analysis, or one sd for all.")
                 .by_default("covariance")
                 .with("type", cycles),
             key("positions", boolean(), "The points are data.").by_default(true).with("type", cycles),
             key("multipliers", boolean(), "ln|multiplier| is data.").by_default(false).with("type", cycles),
             key("interval", choice({"auto", "segment"}) | whole(1, longest_interval),
                 "Samples or sections from node to node; \"segment\": one initial state per segment.")
                 .with("type", series),
             key("matching", matching(), "How well the end of one interval meets the beginning of the next.")
                 .by_default("auto")
                 .with("type", series),
             key("period", per_experiment(whole(1, longest_period)), "Forced models: in periods of the forcing.")
                 .by_default(1)
                 .with("type", waveform),
             key("time", per_experiment(above(0.0)), "Autonomous models: a guess of the period.")
                 .in("s")
                 .with("type", waveform),
             key("phase", per_experiment(number() | choice({"estimate"})),
                 "Of the forcing at the time 0 of the record.")
                 .in("rad")
                 .by_default("estimate")
                 .with("type", waveform),
             key("offset",
                 choice({"estimate", "none"}) |
                     entries(number() | choice({"estimate", "none"}), "an observed coordinate"),
                 "A constant that the readings are off by, in the coordinate's unit.")
                 .by_default("none")
                 .with("type", waveform),
             key("start", entries(list(state()), "an experiment"), "States at phase 0, one per period of the orbit.")
                 .with("type", waveform),
             key("errors", errors(), "How readings err, by coordinate; one left out is normal with an estimated sd."),
             key("covariance", covariance(), "Coordinates whose errors have one full covariance.")}));
}

}  // namespace orbid::apps::describe
