#pragma once

#include <filesystem>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

#include "apps/campaign/plan/campaign.hpp"
#include "apps/job/blocks/field_table.hpp"
#include "apps/job/job.hpp"

namespace orbid::apps {

/// A campaign while its file is read.
struct CampaignText {
    Campaign campaign;
    Job place;                   ///< its source is that of the campaign: relative paths start there
    nlohmann::ordered_json raw;  ///< the file, for values that are taken as they are
    std::string record_key = "/data/file";

    /// A value of the file as it is written.
    [[nodiscard]] const nlohmann::ordered_json& written(const ValueReader& value) const {
        return raw.at(nlohmann::ordered_json::json_pointer(value.pointer()));
    }
};

/// A key that is read and never written: a campaign is stored as Campaign::document().
template <class Block>
[[nodiscard]] Field<Block> reading_field(KeySchema key, typename Field<Block>::Read read) {
    return {std::move(key), std::move(read), [](const Block&, const Writing&) { return left_out(); }};
}

/// The keys of a campaign: schema, reference page and reader walk over them.
[[nodiscard]] const FieldTable<CampaignText>& campaign_fields();
/// "vary", "grid", "records" and their parts.
void add_variation_fields(FieldTable<CampaignText>& table);

/// The word that stands for a pointer in tables: its last key, with the one before where that is a mere "start".
[[nodiscard]] std::string column_name(const std::string& pointer);

}  // namespace orbid::apps
