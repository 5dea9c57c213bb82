#include <algorithm>
#include <cstddef>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "orbits/local_maps/local_map.hpp"

namespace orbid::apps {

namespace describe {

namespace {

using Search = orbits::CycleSearchOptions;
using Json = nlohmann::ordered_json;

// A local fit over more points than this is no longer local in any series of usable length.
constexpr double most_neighbours = 100000;
// The least that a local map of one coordinate takes: two coefficients and two more.
constexpr double fewest_neighbours = 4;
// Only guards the conversion to int.
constexpr double most_recurrences = 1e9;

/// Number of coefficients of a local map of n coordinates, intercept included, plus the two that
/// CycleSearchOptions::neighbours asks for.
std::uint64_t fewest_neighbours_of(std::size_t n, int order) {
    // Left to the data, the order may be as low as 1.
    return static_cast<std::uint64_t>(orbits::coefficient_count(static_cast<Eigen::Index>(n), std::max(order, 1))) + 2;
}

void take_paper_defaults(const ValueReader&, const Job&, OrbitsJob& orbits) {
    if (orbits.search.method != Search::Method::closest_return) return;
    orbits.search.box = 0.01;  // the paper's
    orbits.search.minimum_recurrences = 3;
}

void check_local_map(const ValueReader& value, const Job&, OrbitsJob& orbits) {
    if (orbits.search.method == Search::Method::closest_return && orbits.search.order > 1)
        value.report("with \"method\": \"closest_return\" maps are linear: must be \"linear\" or left out");
}

void read_neighbours(const ValueReader& value, const Job& job, OrbitsJob& orbits) {
    const std::size_t n = std::max<std::size_t>(coordinate_names(job).size(), 1);
    const std::uint64_t fewest = fewest_neighbours_of(n, orbits.search.order);
    const auto number = value.number([&](double x) { return x >= static_cast<double>(fewest); },
                                     fmt::format("at least {}, the coefficients of a local map and two more", fewest));
    orbits.search.neighbours = static_cast<int>(number.value_or(0));
}

void read_use_of_symmetry(const ValueReader& value, const Job& job, OrbitsJob& orbits) {
    const bool wanted = value.boolean().value_or(orbits.search.symmetry_signs.has_value());
    if (wanted && !orbits.search.symmetry_signs && job.model.system)
        value.report(fmt::format("the model {} has no symmetry that maps the section onto itself; must be false",
                                 job.model.name));
    if (!wanted) orbits.search.symmetry_signs.reset();
}

/// "estimate", or { "phi": 1e-3, "phi_dot": 0.02 }: sds of all coordinates that the section has.
void read_reading_error(const ValueReader& value, const Job& job, OrbitsJob& orbits) {
    if (!value.is(JsonValue::Kind::object)) return;
    const auto coordinates = coordinate_names(job);
    Eigen::VectorXd sds = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(coordinates.size()));
    ObjectReader object(value);
    for (std::size_t i = 0; i < coordinates.size(); ++i) {
        if (job.section_plane && static_cast<Eigen::Index>(i) == job.section_plane->coordinate) continue;
        if (const auto sd = object.require(coordinates[i], "the sd of a reading, in the coordinate's unit"))
            sds[static_cast<Eigen::Index>(i)] = sd->number().value_or(1.0);
    }
    object.finish();
    orbits.reading_sd = std::move(sds);
}

Json reading_error_document(const OrbitsJob& orbits, const Writing& at) {
    if (orbits.reading_sd.size() == 0) return "estimate";
    Json sds = Json::object();
    for (Eigen::Index i = 0; i < orbits.reading_sd.size(); ++i) {
        if (at.job.section_plane && i == at.job.section_plane->coordinate) continue;
        sds[coordinate_name(at.job, i)] = orbits.reading_sd[i];
    }
    return sds;
}

void read_boundaries(const ValueReader& value, const Job&, orbits::Partition& partition) {
    for (const ValueReader& item : value.items()) {
        const auto boundary = item.number();
        if (boundary && !partition.boundaries.empty() && !(*boundary > partition.boundaries.back()))
            item.report(fmt::format("must be above the boundary before it, {}", partition.boundaries.back()));
        partition.boundaries.push_back(boundary.value_or(0.0));
    }
}

void check_symbols(const ValueReader& value, const Job&, orbits::Partition& partition) {
    if (value.is(JsonValue::Kind::string) && partition.symbols.size() != partition.boundaries.size() + 1)
        value.report(fmt::format("must have one character per part: {}, not {}", partition.boundaries.size() + 1,
                                 partition.symbols.size()));
}

const FieldTable<orbits::Partition>& partition_fields() {
    using orbits::Partition;
    static const FieldTable<Partition> table{
        coordinate_field(
            key("coordinate", text(), "The coordinate whose value decides about the symbol.").required_always(),
            &Partition::coordinate)
            .with_rule([](const ValueReader& value, const Job& job, Partition& partition) {
                if (job.section_plane && partition.coordinate == job.section_plane->coordinate)
                    value.report("has the same value at all points of the section; must be another coordinate");
            }),
        {key("boundaries", list(number()), "Values between the parts, ascending.").required_always(), read_boundaries,
         [](const Partition& partition, const Writing&) -> Json { return partition.boundaries; }},
        open_field(key("symbols", text(), "One character per part, from below.").required_always(), &Partition::symbols)
            .with_rule(check_symbols)};
    return table;
}

/// Of { "complete_to": 8, "continuous": true }, for a cycle expansion beside the invariants of the series.
const FieldTable<OrbitsJob>& invariants_fields() {
    using Expansion = orbits::CycleExpansionOptions;
    static const FieldTable<OrbitsJob> table{
        {key("complete_to", whole(1, longest_period),
             "The period up to which the list of cycles is complete: a cycle expansion is made besides.")
             .required_always(),
         [](const ValueReader& value, const Job&, OrbitsJob& orbits) {
             const auto& searched = orbits.search.periods;
             const int longest = *std::max_element(searched.begin(), searched.end());
             orbits.expansion.complete_to =
                 static_cast<int>(value.whole(1, static_cast<std::uint64_t>(longest)).value_or(1));
             for (int p = 1; p <= orbits.expansion.complete_to; ++p)
                 if (std::count(searched.begin(), searched.end(), p) == 0)
                     value.report(
                         fmt::format("period {} is not searched for: it does not stand in /orbits/periods", p));
         },
         [](const OrbitsJob& orbits, const Writing&) -> Json { return orbits.expansion.complete_to; }},
        field(key("continuous", boolean(), "The map of the section onto itself is continuous."), &OrbitsJob::expansion,
              &Expansion::continuous)};
    return table;
}

void read_invariants(const ValueReader& value, const Job& job, OrbitsJob& orbits) {
    if (!value.is(JsonValue::Kind::object)) return value.read(orbits.invariants);
    orbits.invariants = true;
    read_object(value, invariants_fields(), orbits, job);
}

Json invariants_document(const OrbitsJob& orbits, const Writing& at) {
    if (orbits.expansion.complete_to == 0) return orbits.invariants;
    return fields_document(orbits, invariants_fields(), at);
}

/// Symmetry of the model that maps the section onto itself: one with a shift in phase maps it onto another section,
/// and so does one that moves its plane.
std::optional<models::Symmetry> section_symmetry(const Job& job) {
    const auto symmetry = job.model.system ? job.model.system->symmetry() : std::nullopt;
    const bool usable =
        symmetry && symmetry->phase_shift == 0.0 &&
        (!job.section_plane || symmetry->signs[static_cast<std::size_t>(job.section_plane->coordinate)] > 0.0);
    if (!usable) return std::nullopt;
    return symmetry;
}

/// Keys of a search; all are refused beside a file of cycles.
FieldTable<OrbitsJob> cycle_search_fields() {
    const auto search = &OrbitsJob::search;
    FieldTable<OrbitsJob> table{
        choice_field(
            key("method", {},
                "How the map of the section onto itself is told from the data; \"closest_return\" is the paper's way."),
            cycle_method_names, search, &Search::method)
            .with_rule(take_paper_defaults),
        {key("periods", periods(), "The periods that are searched for.").by_default(Search{}.periods),
         [](const ValueReader& value, const Job&, OrbitsJob& orbits) {
             orbits.search.periods = read_periods(value).value_or(orbits.search.periods);
         },
         [](const OrbitsJob& orbits, const Writing&) -> Json { return orbits.search.periods; }},
        field(key("box", between(0.0, 0.5),
                  "Linear size of a recurrence box relative to the range of the series; 0.01 with \"closest_return\"."),
              search, &Search::box),
        choice_field(key("local_map", {}, "Order of the local maps; left to the data, cycle by cycle, with \"auto\"."),
                     local_map_names, search, &Search::order)
            .with_rule(check_local_map)
            .written_after("neighbours"),
        {key("neighbours", whole(fewest_neighbours, most_neighbours),
             "Points of a local fit: at least its coefficients and two more; chosen by the data unless given."),
         read_neighbours,
         [](const OrbitsJob& orbits, const Writing&) {
             return orbits.search.neighbours > 0 ? Json(orbits.search.neighbours) : left_out();
         }},
        field(key("minimum_recurrences", whole(1, most_recurrences),
                  "Points of the series that lead to a cycle; cycles with fewer are left out (\"closest_return\": 3)."),
              search, &Search::minimum_recurrences),
        {key("symmetry", boolean(),
             "Use the symmetry that the model declares; where it has one that maps the section onto "
             "itself, the default is true."),
         read_use_of_symmetry,
         [](const OrbitsJob& orbits, const Writing&) -> Json { return orbits.search.symmetry_signs.has_value(); }},
        {key("reading_error", choice({"estimate"}) | entries(above(0.0), "a coordinate of the section"),
             "Standard deviations of a reading, of all coordinates that the section has.")
             .by_default("estimate"),
         read_reading_error, reading_error_document},
        object_field<OrbitsJob>(
            key("partition", {}, "Names parts of the section, so that cycles get codes."), partition_fields(),
            [](auto& orbits) -> auto& { return orbits.search.partition; }),
        embedding_field(),
        field(key("always", boolean(), "Cycles are searched for even where the estimate turns out to need none."),
              &OrbitsJob::always)
            .written_if([](const OrbitsJob& orbits) { return orbits.always; }),
        {key("invariants", boolean() | object(keys_of(invariants_fields())),
             "Exponents, dimensions and entropies of the series.")
             .by_default(false),
         read_invariants, invariants_document}};
    for (Field<OrbitsJob>& one : table)
        one.key.without("file");
    return table;
}

}  // namespace

const FieldTable<OrbitsJob>& orbits_fields() {
    static const FieldTable<OrbitsJob> table = [] {
        FieldTable<OrbitsJob> fields{
            file_field(key("file", file_name(),
                           "A list of cycles (cycles.json) to be used as it is, in the place of a search."),
                       &OrbitsJob::file),
            text_field(key("sha256", sha256(), "Of that file: refused if it has changed.").with("file"),
                       &OrbitsJob::sha256)};
        const auto search = cycle_search_fields();
        fields.insert(fields.end(), search.begin(), search.end());
        return fields;
    }();
    return table;
}

}  // namespace describe

namespace {

/// The first section series is searched; without one the first record of samples, cut by the job's section.
void choose_series(ObjectReader& object, const Job& job, OrbitsJob& orbits) {
    const auto is = [](orbits::Series::Sampling sampling) {
        return [sampling](const DataJob& data) { return data.sampling() == sampling; };
    };
    auto series = std::find_if(job.data.begin(), job.data.end(), is(orbits::Series::Sampling::section));
    const bool samples = series == job.data.end();
    if (samples) series = std::find_if(job.data.begin(), job.data.end(), is(orbits::Series::Sampling::samples));
    if (series == job.data.end()) {
        object.self().report("needs a series in \"data\", or the \"file\" of a list of cycles");
        return;
    }
    orbits.data = static_cast<std::size_t>(series - job.data.begin());
    if (!samples && job.section_from_data)
        object.self().report(
            fmt::format("\"section\": \"auto\" is chosen by samples in time, but \"{}\" holds sections", series->name));
    // One coordinate of an autonomous flow is embedded unless told otherwise.
    const bool alone = samples && job.model.is(models::Kind::autonomous) && series->observe.size() == 1 &&
                       job.model.system->dimension() > 1;
    if (alone && !orbits.embedding) orbits.embedding.emplace();
    if (orbits.embedding) describe::check_embedding(object, job, *series, alone, orbits);
    if (samples && job.model.is(models::Kind::autonomous) && !job.section_plane && !job.section_from_data &&
        !orbits.embedding)
        object.self().report(
            fmt::format("samples of {} are cut by a plane: needs \"section\": {{ \"coordinate\": ..., "
                        "\"value\": ..., \"direction\": ... }} or \"auto\"",
                        job.model.name));
    if (samples && orbits.reading_sd.size() > 0)
        object.self().report(
            "the errors of a section cut from samples follow from these: \"reading_error\" must be "
            "\"estimate\"");
    if (series->streamed() && orbits.invariants)
        object.report("invariants",
                      fmt::format("are of records that are read as a whole, but \"{}\" is a stream", series->name));
    if (series->sensor.type == models::Sensor::Type::function)
        object.self().report(fmt::format("cycles read by a sensor \"function\": {}", not_in_this_version));
    if (std::any_of(series + 1, job.data.end(), is(series->sampling())))
        object.self().report(fmt::format("cycles of several series: {}", not_in_this_version));
    if (job.model.system && !orbits.embedding && series->observe.size() < job.model.system->coordinates().size())
        object.self().report(fmt::format("needs every coordinate of the model, but \"{}\" observes {} of {}",
                                         series->name, series->observe.size(), job.model.system->coordinates().size()));
}

}  // namespace

void read_orbits(ObjectReader& root, Job& job) {
    const auto value = root.find("orbits");
    if (!value) return;
    OrbitsJob orbits;
    ObjectReader object(*value);
    const bool searched = object.valid() && !object.find("file");
    if (searched)
        if (const auto symmetry = describe::section_symmetry(job)) orbits.search.symmetry_signs = symmetry->signs;
    read_fields(object, describe::orbits_fields(), orbits, job);
    // Otherwise it is not known which series there are.
    const auto data = root.find("data");
    if (searched && (!data || data->sound())) choose_series(object, job, orbits);
    object.finish();
    job.orbits = std::move(orbits);
}

}  // namespace orbid::apps
