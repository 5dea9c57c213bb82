#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "models/catalogue/registry.hpp"

namespace orbid::apps::describe {

namespace {

/// A number; of equations in the job also with what else is known of the parameter.
ValueSchema parameter() {
    return number() | object(keys_of(equation_parameter_fields()));
}

ValueSchema forcing_phase() {
    return text("the name of a parameter") |
           object(
               {key("name", text(), "What the phase is called in the equations.").by_default("phase"),
                key("frequency", text(), "The parameter omega of the phase omega t.").in("rad/s").required_always()});
}

ValueSchema symmetry() {
    return object(
        {key("signs", entries(one_of({1.0, -1.0}), "a coordinate"),
             "Of the coordinates in the mirror image: { \"x\": -1 }; one not named keeps its sign.")
             .required_always(),
         key("phase_shift", number(), "By which the phase of the mirror image is shifted.").in("rad").by_default(0.0)});
}

}  // namespace

ValueSchema model_block() {
    const auto formula = [](std::string names) { return entries(text("a formula"), std::move(names), {}, 1); };
    return object(
        {key("name", name(), "One of the models that `orbid models` lists; beside \"equations\" a name of their own.")
             .needed_unless("equations"),
         key("variant", text(), "Of the model; the first that `orbid models NAME` lists unless given.")
             .without("equations"),
         key("size", whole(1, models::ModelSize::largest), "Number of coordinates, of a model that leaves it open.")
             .without("equations"),
         key("parameters", entries(parameter(), "a parameter"),
             "Data are simulated at these values, and fixed parameters keep them; those left out have the defaults of "
             "the "
             "model.")
             .needed_with("equations"),
         key("equations", formula("a coordinate"),
             "A model written in the job: the derivative of each coordinate, or its next value: { \"x\": \"v\", \"v\": "
             "\"-k * x\" }."),
         key("coordinates", names(1), "The order of the state; that of \"equations\" unless given.").with("equations"),
         key("definitions", formula("a quantity"), "Formulas that the equations use by name.").with("equations"),
         key("kind", choice({"flow", "map"}), "Derivatives, or next values.").by_default("flow").with("equations"),
         key("units", entries(text(), "a coordinate"), "Of the coordinates.").with("equations"),
         key("forcing_phase", forcing_phase(), "Forced models: the frequency, and the name of the phase.")
             .with("equations"),
         key("angles", names(), "Coordinates that are angles, in rad.").standard_text("[]").with("equations"),
         key("switching", set(text()), "Expressions at whose zeros the equations jump.").with("equations"),
         key("inputs", entries(text(), "an input"), "Measured inputs with their units.").with("equations"),
         key("symmetry", symmetry(), "Of the solutions.").with("equations"),
         key("stiff", boolean(), "Slow and fast scales far apart: steps by an implicit method.")
             .by_default(false)
             .with("equations"),
         key("compile", choice({"auto"}) | boolean(), "Compile the equations; \"auto\": where it is worth it.")
             .by_default("auto")
             .with("equations")});
}

}  // namespace orbid::apps::describe
