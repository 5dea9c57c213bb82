#include "apps/campaign/plan/campaign_tasks.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "apps/documents/fingerprint.hpp"
#include "apps/documents/json_reader.hpp"
#include "apps/documents/json_value.hpp"
#include "estimator/interface/random_stream.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

std::vector<std::string> keys_of_object(const Json& object) {
    std::vector<std::string> keys;
    for (const auto& item : object.items())
        keys.push_back(item.key());
    return keys;
}

/// Whether two pointers set the same value, or one sets a part of what the other sets.
bool overlap(const std::string& one, const std::string& other) {
    const std::string& shorter = one.size() <= other.size() ? one : other;
    const std::string& longer = one.size() <= other.size() ? other : one;
    return longer.starts_with(shorter) && (longer.size() == shorter.size() || longer[shorter.size()] == '/');
}

void check_columns(const std::vector<VariedColumn>& columns) {
    for (std::size_t i = 0; i < columns.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j) {
            if (columns[i].name == columns[j].name)
                throw std::invalid_argument(fmt::format(
                    "two things that vary are called \"{}\": give one of them another \"name\"", columns[i].name));
            if (!columns[i].pointer.empty() && !columns[j].pointer.empty() &&
                overlap(columns[i].pointer, columns[j].pointer))
                throw std::invalid_argument(fmt::format("{} varies twice: by \"{}\" and by \"{}\"", columns[i].pointer,
                                                        columns[j].name, columns[i].name));
        }
    }
}

/// How many numbers there were.
std::size_t multiply_numbers(Json& value, double factor) {
    if (value.is_number()) {
        value = value.get<double>() * factor;
        return 1;
    }
    std::size_t numbers = 0;
    if (value.is_structured())
        for (Json& part : value)
            numbers += multiply_numbers(part, factor);
    return numbers;
}

/// A parameter of a grid keeps its value: it leaves the estimate.
void hold(Json& job, const std::string& parameter) {
    if (const auto model = job.find("model");
        model != job.end() && model->is_object() && !model->contains("parameters"))
        (*model)["parameters"] = Json::object();
    if (const auto estimate = job.find("estimate"); estimate != job.end() && estimate->contains("parameters"))
        (*estimate)["parameters"].erase(parameter);
}

}  // namespace

void set_value(Json& job, const std::string& pointer, const Json& value) {
    Json* at = &job;
    std::string passed;
    const Json::json_pointer whole(pointer);
    std::vector<std::string> keys;
    for (Json::json_pointer rest = whole; !rest.empty(); rest = rest.parent_pointer())
        keys.insert(keys.begin(), rest.back());
    if (keys.empty()) throw std::invalid_argument("\"\" is the whole job: name a key of it, \"/model/parameters/k\"");
    for (std::size_t i = 0; i < keys.size(); ++i) {
        const bool last = i + 1 == keys.size();
        const std::string there = passed.empty() ? "the job" : passed;
        if (at->is_object()) {
            if (!last && !at->contains(keys[i]))
                throw std::invalid_argument(fmt::format("{} leads nowhere: {} has no \"{}\"{}", pointer, there, keys[i],
                                                        suggestion(keys[i], keys_of_object(*at))));
            at = &(*at)[keys[i]];
        } else if (at->is_array()) {
            const bool number = !keys[i].empty() && keys[i].find_first_not_of("0123456789") == std::string::npos;
            if (!number || keys[i].size() > 9 || std::stoul(keys[i]) >= at->size())
                throw std::invalid_argument(fmt::format("{} leads nowhere: {} is a list of {}, \"{}\" is none of them",
                                                        pointer, there, at->size(), keys[i]));
            at = &(*at)[std::stoul(keys[i])];
        } else {
            throw std::invalid_argument(
                fmt::format("{} leads nowhere: {} is neither an object nor a list", pointer, there));
        }
        passed = child_pointer(passed, keys[i]);
    }
    // A parameter with a unit: "k": { "value": 3, "unit": "N/m" }.
    if (at->is_object() && at->contains("value") && !value.is_object()) at = &(*at)["value"];
    *at = value;
}

void multiply_value(Json& job, const std::string& pointer, double factor) {
    const Json::json_pointer place(pointer);
    if (!job.contains(place) || multiply_numbers(job[place], factor) == 0)
        throw std::invalid_argument(fmt::format("{}: the job has no number there to multiply", pointer));
}

double CampaignTasks::count_of(const Campaign& campaign) {
    double count = static_cast<double>(campaign.jobs.size()) * static_cast<double>(campaign.replicates);
    for (const VariedFactor& factor : campaign.factors)
        count *= static_cast<double>(factor.settings.size());
    return count;
}

CampaignTasks::CampaignTasks(Campaign campaign) : campaign_(std::move(campaign)) {
    const double count = count_of(campaign_);
    if (count > static_cast<double>(most))
        throw std::invalid_argument(fmt::format("{:.6g} tasks: at most {} can be run", count, most));
    count_ = static_cast<std::int64_t>(count);
    for (const BaseJob& job : campaign_.jobs) {
        bases_.push_back(json_value_or_discarded<Json>(job.text, true));
        if (!bases_.back().is_object())
            throw std::invalid_argument(fmt::format("{}: is not a job: no object of JSON", job.source.string()));
        for (const std::string& parameter : campaign_.held)
            hold(bases_.back(), parameter);
        base_keys_.push_back(sha256(bases_.back().dump() + '\n' + job.source.string()));
    }
    if (campaign_.jobs.size() > 1 || !campaign_.jobs.front().name.empty()) columns_.push_back({"job", ""});
    for (const VariedFactor& factor : campaign_.factors)
        for (std::size_t key = 0; key < factor.names.size(); ++key)
            columns_.push_back({factor.names[key], factor.pointers[key]});
    for (const VariedDraw& draw : campaign_.draws)
        columns_.push_back({draw.name, draw.pointer, true});
    if (campaign_.seeded || campaign_.replicates > 1)
        columns_.push_back({"seed", campaign_.seeded ? "/seed" : "", true});
    check_columns(columns_);
    for (const Json& base : bases_) {
        Json tried = base;
        for (const VariedFactor& factor : campaign_.factors)
            if (factor.multiplied) multiply_value(tried, factor.pointers.front(), 1.0);
        for (const VariedColumn& column : columns_)
            if (!column.pointer.empty()) set_value(tried, column.pointer, nullptr);
    }
}

CampaignTasks::Place CampaignTasks::place(std::int64_t number) const {
    Place at;
    at.replicate = number % campaign_.replicates;
    std::int64_t rest = number / campaign_.replicates;
    at.settings.resize(campaign_.factors.size());
    for (std::size_t i = campaign_.factors.size(); i-- > 0;) {
        const auto settings = static_cast<std::int64_t>(campaign_.factors[i].settings.size());
        at.settings[i] = static_cast<std::size_t>(rest % settings);
        rest /= settings;
    }
    at.job = static_cast<std::size_t>(rest);
    return at;
}

double CampaignTasks::drawn(std::size_t draw, std::int64_t replicate) const {
    const VariedDraw& one = campaign_.draws[draw];
    estimator::RandomStream random(campaign_.seed + static_cast<std::uint64_t>(replicate),
                                   estimator::RandomPurpose::campaign_draw, draw);
    switch (one.distribution) {
        case VariedDraw::Distribution::uniform:
            return random.uniform(one.first, one.second);
        case VariedDraw::Distribution::log_uniform:
            return std::exp(random.uniform(std::log(one.first), std::log(one.second)));
        case VariedDraw::Distribution::normal:
            break;
    }
    return one.first + one.second * random.normal();
}

TaskPlan CampaignTasks::plan(std::int64_t number) const {
    const Place at = place(number);
    TaskPlan plan;
    plan.number = number;
    if (!columns_.empty() && columns_.front().pointer.empty() && columns_.front().name == "job")
        plan.values.push_back(Json(campaign_.jobs[at.job].name).dump());
    for (std::size_t i = 0; i < campaign_.factors.size(); ++i)
        for (const Json& value : campaign_.factors[i].settings[at.settings[i]])
            plan.values.push_back(value.dump());
    for (std::size_t i = 0; i < campaign_.draws.size(); ++i)
        plan.values.push_back(Json(drawn(i, at.replicate)).dump());
    if (campaign_.seeded || campaign_.replicates > 1) {
        plan.seed = static_cast<std::int64_t>(campaign_.seed) + at.replicate;
        plan.values.push_back(std::to_string(*plan.seed));
    }
    std::string text = base_keys_[at.job];
    for (std::size_t i = 0; i < plan.values.size(); ++i)
        text += '\n' + columns_[i].pointer + ' ' + plan.values[i];
    plan.key = sha256(text);
    return plan;
}

std::string CampaignTasks::job_text(std::int64_t number) const {
    const Place at = place(number);
    Json job = bases_[at.job];
    for (std::size_t i = 0; i < campaign_.factors.size(); ++i) {
        const VariedFactor& factor = campaign_.factors[i];
        if (factor.multiplied) {
            multiply_value(job, factor.pointers.front(), factor.settings[at.settings[i]].front().get<double>());
            continue;
        }
        for (std::size_t key = 0; key < factor.pointers.size(); ++key)
            set_value(job, factor.pointers[key], factor.settings[at.settings[i]][key]);
    }
    for (std::size_t i = 0; i < campaign_.draws.size(); ++i)
        set_value(job, campaign_.draws[i].pointer, drawn(i, at.replicate));
    if (campaign_.seeded) job["seed"] = campaign_.seed + static_cast<std::uint64_t>(at.replicate);
    return job.dump(2) + "\n";
}

std::vector<KnownValue> CampaignTasks::known(std::int64_t number) const {
    const std::string& job = base(number).name;
    std::vector<KnownValue> values;
    for (const auto& [name, value] : campaign_.known)
        if (name.empty() || name == job) values.push_back(value);
    return values;
}

}  // namespace orbid::apps
