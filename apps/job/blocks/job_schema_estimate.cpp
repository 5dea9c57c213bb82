#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/estimate_job.hpp"

namespace orbid::apps::describe {

namespace {

ValueSchema free_parameter() {
    return named(
        "free_parameter",
        object({key("start", number(), "Where the estimate begins; the model's value unless given.").without("tied"),
                key("scale", choice(scale_names),
                    "On which it is estimated; \"log\" for positive parameters, else \"linear\", unless given.")
                    .without("tied"),
                key("bounds", bounds(), "[lower, upper], inclusive; null stands for no bound.").without("tied"),
                key("prior", prior(), "What is known before the data.").by_default("flat").without("tied"),
                key("tied",
                    text("the name of an estimated parameter") |
                        object({key("to", text(), "An estimated parameter.").required_always(),
                                key("factor", other_than(0.0), "This one is so many times that one.").by_default(1)}),
                    "Follows another parameter.")}));
}

ValueSchema joint_prior() {
    const ValueSchema normal =
        object({key("names", list(text()), "Estimated parameters.").required_always(),
                key("mean", list(number()), "One number per name.").required_always(),
                key("covariance", matrix(), "Symmetric and positive definite, one row per name.").required_always()});
    return object({key("normal", normal, "Several parameters are normal together.").required_always()});
}

ValueSchema strategy() {
    return choice({"auto"}) |
           list(choice({"cycles", "series", "waveform", "prediction", "harvest"}) | set(choice(residual_type_names), 1),
                1);
}

ValueSchema sample() {
    const auto keys = keys_of(sample_fields());
    return keys.front().value | object(keys);
}

ValueSchema parameter_choice() {
    return boolean() | names();
}

}  // namespace

ValueSchema bounds() {
    return list(number() | null(), 2, 2, "[lower, upper]; null stands for no bound");
}

ValueSchema estimate_block() {
    return object(
        {key("parameters", entries(free_parameter(), "a parameter of the model"),
             "The free ones; {} for error scales and initial states alone.")
             .required_always(),
         key("joint_priors", list(joint_prior()), "Priors of several parameters together.").standard_text("[]"),
         key("derived", entries(text(), "a derived quantity"),
             "Formulas of parameters whose values and intervals are shown: { \"k_over_m\": \"k / m\" }.")
             .standard_text("{}"),
         key("residuals", list(residual(), 1), "What is compared; not needed with \"strategy\": \"auto\"."),
         key("variance", choice(variance_names),
             "How error scales are estimated: maximum likelihood, restricted likelihood, or integrated out.")
             .by_default("restricted"),
         key("strategy", strategy(),
             "Stages, each from the best before it; what stands in a list within the list is estimated from together."),
         key("scan", boolean(), "The prediction begins with a coarse scan of the parameters over their bounds.")
             .by_default(false),
         key("multi_start", object(keys_of(multi_start_fields())), "Estimates from several starts; the best goes on."),
         key("posterior", object({key("sample", sample(), "Draws by the No-U-Turn sampler.").by_default(0)}),
             "Draws from the posterior density."),
         key("profile", parameter_choice(), "Likelihood intervals of all parameters, or of those named.")
             .by_default(false),
         key("marginals", parameter_choice(), "Densities with all else integrated out, of all or of those named.")
             .by_default(false),
         key("criticism",
             object({key("variants", names(), "Variants of the model to compare with.").standard_text("[]"),
                     key("without", names(), "Parameters held at 0, one at a time.").standard_text("[]"),
                     key("held_out", from_to(0.0, 0.5), "Share of the data that is left out in turn and predicted.")
                         .by_default(0.0)}),
             "Other models that the estimate is compared with.")});
}

}  // namespace orbid::apps::describe
