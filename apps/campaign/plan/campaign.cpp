#include "apps/campaign/plan/campaign.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/documents/json_text.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

const std::vector<std::string>& distribution_names() {
    static const std::vector<std::string> names{"uniform", "log_uniform", "normal"};
    return names;
}

template <class Enum>
Enum named(const Json& name, const std::vector<std::string>& names) {
    const auto found = std::find(names.begin(), names.end(), name.get<std::string>());
    if (found == names.end()) throw std::runtime_error(fmt::format("\"{}\" is not known", name.get<std::string>()));
    return static_cast<Enum>(found - names.begin());
}

Json factor_document(const VariedFactor& factor) {
    Json document{{"names", factor.names}, {"keys", factor.pointers}, {"settings", factor.settings}};
    if (factor.multiplied) document["multiplied"] = true;
    return document;
}

VariedFactor factor_from(const Json& document) {
    return {document.at("names"), document.at("keys"),
            document.at("settings").get<std::vector<std::vector<nlohmann::ordered_json>>>(),
            document.value("multiplied", false)};
}

Json draw_document(const VariedDraw& draw) {
    return {{"name", draw.name},
            {"key", draw.pointer},
            {distribution_names()[static_cast<std::size_t>(draw.distribution)], {draw.first, draw.second}}};
}

VariedDraw draw_from(const Json& document) {
    VariedDraw draw{document.at("name"), document.at("key"), {}, 0.0, 0.0};
    for (std::size_t i = 0; i < distribution_names().size(); ++i) {
        const auto numbers = document.find(distribution_names()[i]);
        if (numbers == document.end()) continue;
        draw.distribution = static_cast<VariedDraw::Distribution>(i);
        draw.first = numbers->at(0);
        draw.second = numbers->at(1);
    }
    return draw;
}

}  // namespace

Json Campaign::document() const {
    Json document{{"format", "orbid-campaign/1"},
                  {"title", title},
                  {"kind", campaign_kind_names[static_cast<std::size_t>(kind)]}};
    document["jobs"] = json_list(jobs, [](const BaseJob& job) {
        return Json{{"name", job.name}, {"source", job.source.string()}, {"text", job.text}};
    });
    document["factors"] = json_list(factors, factor_document);
    document["draws"] = json_list(draws, draw_document);
    document["seed"] = seed;
    document["replicates"] = replicates;
    document["seeded"] = seeded;
    document["resampled"] = resampled;
    document["held"] = held;
    document["known"] = json_list(known, [](const auto& one) {
        return Json{{"job", one.first},
                    {"parameter", one.second.parameter},
                    {"truth", one.second.truth},
                    {"bound", std::isnan(one.second.bound) ? Json(nullptr) : Json(one.second.bound)}};
    });
    document["seconds"] = seconds;
    return document;
}

Campaign Campaign::from_document(const Json& document) {
    try {
        if (document.at("format") != "orbid-campaign/1")
            throw std::runtime_error(
                fmt::format("format {}, this program reads \"orbid-campaign/1\"", document.at("format").dump()));
        Campaign campaign;
        campaign.title = document.at("title");
        campaign.kind = named<Kind>(document.at("kind"), campaign_kind_names);
        for (const Json& job : document.at("jobs"))
            campaign.jobs.push_back({job.at("name"), job.at("text"), job.at("source").get<std::string>()});
        for (const Json& factor : document.at("factors"))
            campaign.factors.push_back(factor_from(factor));
        for (const Json& draw : document.at("draws"))
            campaign.draws.push_back(draw_from(draw));
        campaign.seed = document.at("seed");
        campaign.replicates = document.at("replicates");
        campaign.seeded = document.at("seeded");
        campaign.resampled = document.at("resampled");
        campaign.held = document.at("held").get<std::vector<std::string>>();
        for (const Json& one : document.at("known")) {
            KnownValue value{one.at("parameter"), one.at("truth")};
            if (!one.at("bound").is_null()) value.bound = one.at("bound");
            campaign.known.emplace_back(one.at("job"), value);
        }
        campaign.seconds = document.at("seconds");
        return campaign;
    } catch (const nlohmann::json::exception& error) {
        throw std::runtime_error(fmt::format("not a campaign: {}", error.what()));
    }
}

}  // namespace orbid::apps
