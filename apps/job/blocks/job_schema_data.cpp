#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

constexpr double most_simulated_trajectories = 1e6;

ValueSchema column() {
    return named("column", header() | object(keys_of(column_fields())));
}

ValueSchema time_column() {
    return named("time_column", header() | object({key("column", header(), "Its header in the file.").required_always(),
                                                   key("unit", text(), "Of the time.").by_default("s")}));
}

ValueSchema columns() {
    return entries(column(), "a coordinate of the model",
                   {key("segment", header(), "The column that numbers or names the segments."),
                    key("time", time_column(), "The column of the time; samples need one.")});
}

ValueSchema inputs() {
    return entries(column(), "an input of the model",
                   {key("file", file_name(), "A table of their own; left out, they stand in the table of the data."),
                    key("sha256", sha256(), "Of that file: refused if it has changed.").with("file"),
                    key("time", time_column(), "Its column of the time.").with("file").by_default("t")});
}

ValueSchema sensor() {
    const std::vector<std::string> difference{"angle_difference"};
    return object(
        {key("type", choice({"state", "function", "angle_difference"}),
             "\"state\" reads the state as it is, \"function\" formulas of it, \"angle_difference\" a rate as the "
             "difference of two readings of an angle.")
             .required_always(),
         key("readings", entries(text(), "a coordinate", {}, 1), "Formulas: { \"x\": \"x^2 + y\" }.")
             .with("type", {"function"})
             .required_always(),
         key("angle", text(), "The coordinate that an encoder reads.").needed_with("type", difference),
         key("rate", text(), "The coordinate that the difference quotient stands for.")
             .with("type", difference)
             .required_always(),
         key("delay", above(0.0), "Between the two readings of the angle.")
             .in("s")
             .with("type", difference)
             .required_always(),
         key("step", at_least(0.0), "Of the encoder, in the unit of the angle.").by_default(0.0),
         key("rounding", choice(rounding_names), "Readings are whole steps; needs a step > 0.").by_default("none")});
}

ValueSchema noise() {
    return entries(
        at_least(0.0) |
            object({key("sd", at_least(0.0), "Standard deviation of a reading.").required_always(),
                    key("correlation", between(-1.0, 1.0), "From one reading to the next.").by_default(0.0)}),
        "a coordinate of the model");
}

ValueSchema simulate() {
    return object(
        {key("sections", whole(1, most_simulated_points),
             "Points of the section of all trajectories together; iterates of a map."),
         key("samples", object(keys_of(samples_fields())), "Samples in time in the place of sections."),
         key("trajectories", whole(1, most_simulated_trajectories), "One segment each.").by_default(1),
         key("transient", whole(0, most_simulated_points),
             "Thrown away before the first point: periods, or steps of samples; 300 for sections from random states, "
             "else 0."),
         key("initial", choice({"random"}) | list(state(), 1), "States to begin at, one per trajectory.")
             .by_default("random"),
         key("restart", choice({"when_captured_or_at_rest", "never"}),
             "A trajectory that comes to rest or to a stable orbit is begun anew, or only reported.")
             .by_default("when_captured_or_at_rest"),
         key("noise", noise(), "Standard deviation of a reading, in the coordinate's unit.").standard_text("{}")},
        {"sections", "samples"});
}

ValueSchema labels(std::size_t fewest) {
    ValueSchema label = text() | number();
    return set(label, fewest);
}

ValueSchema segments() {
    return object({key("fit", choice({"all"}) | labels(1), "Segments that are fitted.").by_default("all"),
                   key("predict", labels(0), "Segments that are predicted, not fitted.").standard_text("[]")});
}

ValueSchema initial_value() {
    return choice({"estimate"}) |
           object({key("value", number(), "Held at this value."),
                   key("start", number(), "Of the estimate; from the data unless given.").without("value"),
                   key("prior", prior(), "What is known of it.").by_default("flat").without("value"),
                   key("scale", choice({"linear", "log"}),
                       "On which it is estimated; \"log\" by default where its prior is one of positive numbers.")
                       .by_default("linear")
                       .without("value"),
                   key("bounds", bounds(), "[lower, upper]; null stands for no bound.").without("value")});
}

}  // namespace

ValueSchema data_block() {
    return named(
        "experiment",
        object({key("name", name(), "Of the experiment; run1, run2, ... unless given."),
                key("simulate", simulate(), "Data made by the model at the job's parameters."),
                key("file", file_name(), "Recorded data: .csv, .tsv, .txt, .h5 or .hdf5, relative to the job."),
                key("sha256", sha256(), "Of the file: refused if it has changed.").with("file"),
                key("kind", choice(sampling_names), "One reading per period of the forcing, or samples in time.")
                    .with("file")
                    .required_always(),
                key("columns", columns(), "Which column of a table is what; unless given those that orbid writes.")
                    .with("file"),
                key("missing", choice({"empty", "nan"}), "What marks a missing sample; \"nan\": that word too.")
                    .with("file")
                    .by_default("empty"),
                key("inputs", inputs(), "Columns of the measured inputs that the model reads."),
                key("interpolation", choice(interpolation_names), "Of the inputs between their samples.")
                    .with("inputs")
                    .by_default("linear"),
                key("sensor", sensor(), "What the instrument reads.").standard_text(R"({ "type": "state" })"),
                key("observe", names(1), "Coordinates that are data; unless given all that have a column."),
                key("parameters", entries(number(), "a parameter of the model"),
                    "Values that hold for this experiment only.")
                    .standard_text("{}"),
                key("free", names(), "Parameters that are estimated for this experiment alone, as NAME@EXPERIMENT.")
                    .standard_text("[]"),
                key("segments", segments(), "Which segments are fitted, and which predicted."),
                key("initial_state", entries(initial_value(), "a coordinate of the model"),
                    "Samples: where the state at the beginning of each segment comes from.")},
               {"simulate", "file"}));
}

}  // namespace orbid::apps::describe
