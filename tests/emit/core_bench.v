// A test bench of one core in Verilog: it loads the images of a folder `core<number>` that --emit vectors wrote, plays
// axon_spikes, computes every compartment of every step, and compares spikes, u and v. Put a design under test in place
// of `update` and `deliver`. Field positions are those of loihi-sim; manifest.yaml has them for other chips.
//
//   iverilog -g2012 -Pcore_bench.COMPARTMENTS=... (the other sizes) -o bench core_bench.v && vvp bench +folder=core0
module core_bench;
  parameter AXONS = 1, LISTS = 1, WORDS = 1, FORMATS = 1, PROFILES = 1, THRESHOLDS = 1, COMPARTMENTS = 1, STEPS = 1;
  parameter signed [31:0] VMIN = -8388607, VMAX = 8388607;
  localparam SLOTS = 64;

  reg [29:0] axons[0:AXONS-1];
  reg [39:0] lists[0:LISTS-1];
  reg [63:0] memory[0:WORDS-1];
  reg [16:0] formats[0:FORMATS-1];
  reg [32:0] profiles[0:PROFILES-1];
  reg [16:0] thresholds[0:THRESHOLDS-1];
  reg [35:0] compartments[0:COMPARTMENTS-1];
  reg [AXONS-1:0] axon_spikes[0:STEPS-1];
  reg [COMPARTMENTS-1:0] spikes[0:STEPS-1];
  reg [23:0] expected_u[0:STEPS*COMPARTMENTS-1];
  reg [23:0] expected_v[0:STEPS*COMPARTMENTS-1];

  reg signed [63:0] due[0:SLOTS*COMPARTMENTS-1];
  reg signed [63:0] u[0:COMPARTMENTS-1], v[0:COMPARTMENTS-1], joined[0:COMPARTMENTS-1];
  integer blocked[0:COMPARTMENTS-1];
  reg [COMPARTMENTS-1:0] fired;
  integer step, i, differ;
  reg [8*256-1:0] folder;

  function signed [63:0] decayed(input signed [63:0] x, input [12:0] d);
    decayed = x < 0 ? -((-x * (4096 - d)) >>> 12) : (x * (4096 - d)) >>> 12;
  endfunction

  function signed [63:0] wrapped(input signed [63:0] x, input integer bits);
    wrapped = ((x + (64'sd1 <<< bits)) & ((64'sd1 <<< (bits + 1)) - 1)) - (64'sd1 <<< bits);
  endfunction

  // Bits `low` and up of a run that begins at a memory word.
  function [31:0] taken(input integer at, input integer low, input integer width);
    integer k;
    begin
      taken = 0;
      for (k = 0; k < width; k = k + 1) taken[k] = memory[at+(low+k)/64][(low+k)%64];
    end
  endfunction

  function signed [63:0] weight(input [31:0] stored, input [16:0] form);
    reg signed [63:0] m;
    integer bits;
    begin
      bits = form[3:0];
      case (form[5:4])
        0: m = (stored[bits-1] ? $signed({32'd0, stored}) - (64'sd1 <<< bits) : $signed({32'd0, stored})) <<< (9 - bits);
        1: m = $signed({32'd0, stored}) <<< (8 - bits);
        default: m = -($signed({32'd0, stored}) <<< (8 - bits));
      endcase
      weight = ($signed(form[9:6]) >= 0 ? m <<< form[9:6] : m >>> -$signed({{28{form[9]}}, form[9:6]})) <<< 6;
    end
  endfunction

  task deliver(input integer axon);
    integer l, at, stop, count, s, low, target, slot;
    reg [16:0] form;
    for (l = axons[axon][14:0]; l < axons[axon][14:0] + axons[axon][29:15]; l = l + 1) begin
      at = lists[l][14:0];
      stop = at + lists[l][29:15];
      target = lists[l][39:30];
      while (at < stop) begin
        form = formats[memory[at][3:0]];
        count = memory[at][9:4] + 1;
        low = 10;
        for (s = 0; s < count; s = s + 1) begin
          slot = (step + 1 + taken(at, low + form[3:0], form[12:10])) % SLOTS;
          if (form[16:13] != 0) target = taken(at, low + form[3:0] + form[12:10], form[16:13]);
          due[slot*COMPARTMENTS+target] = due[slot*COMPARTMENTS+target] + weight(taken(at, low, form[3:0]), form);
          if (form[16:13] == 0) target = target + 1;
          low = low + form[3:0] + form[12:10] + form[16:13];
        end
        at = at + (low + 63) / 64;
      end
    end
  endtask

  task update(input integer c);
    reg [32:0] profile;
    reg signed [63:0] bias, x;
    integer slot;
    begin
      profile = profiles[compartments[c][4:0]];
      slot = (step % SLOTS) * COMPARTMENTS + c;
      bias = $signed(compartments[c][21:9]);
      bias = bias <<< compartments[c][24:22];
      u[c] = wrapped(decayed(u[c], profile[12:0]) + wrapped(due[slot], 21), 23);
      due[slot] = 0;
      x = decayed(v[c], profile[25:13]) + wrapped(u[c] + bias, 23) + joined[c];
      x = x > VMAX ? VMAX : x < VMIN ? VMIN : x;
      fired[c] = 0;
      if (blocked[c] > 0) begin
        blocked[c] = blocked[c] - 1;
        x = 0;
      end else if (!profile[32] && x > $signed({41'd0, thresholds[compartments[c][8:5]], 6'd0})) begin
        fired[c] = 1;
        blocked[c] = profile[31:26] - 1;
        x = 0;
      end
      v[c] = x;
      joined[c] = 0;
      if (compartments[c][25]) joined[compartments[c][35:26]] = joined[compartments[c][35:26]] + x;
    end
  endtask

  initial begin
    if (!$value$plusargs("folder=%s", folder)) folder = "core0";
    $readmemh({folder, "/axons.hex"}, axons);
    $readmemh({folder, "/lists.hex"}, lists);
    $readmemh({folder, "/synapses.hex"}, memory);
    $readmemh({folder, "/formats.hex"}, formats);
    $readmemh({folder, "/profiles.hex"}, profiles);
    $readmemh({folder, "/thresholds.hex"}, thresholds);
    $readmemh({folder, "/compartments.hex"}, compartments);
    $readmemh({folder, "/axon_spikes.hex"}, axon_spikes);
    $readmemh({folder, "/spikes.hex"}, spikes);
    $readmemh({folder, "/u.hex"}, expected_u);
    $readmemh({folder, "/v.hex"}, expected_v);
    for (i = 0; i < SLOTS * COMPARTMENTS; i = i + 1) due[i] = 0;
    for (i = 0; i < COMPARTMENTS; i = i + 1) begin
      u[i] = 0;
      v[i] = 0;
      joined[i] = 0;
      blocked[i] = 0;
    end
    differ = 0;
    for (step = 0; step < STEPS; step = step + 1) begin
      for (i = 0; i < COMPARTMENTS; i = i + 1) update(i);
      for (i = 0; i < COMPARTMENTS; i = i + 1)
        differ = differ + (u[i][23:0] !== expected_u[step*COMPARTMENTS+i]) + (v[i][23:0] !== expected_v[step*COMPARTMENTS+i])
               + (fired[i] !== spikes[step][i]);
      for (i = 0; i < AXONS; i = i + 1) if (axon_spikes[step][i]) deliver(i);
    end
    $display("%0d of %0d values differ", differ, 3 * STEPS * COMPARTMENTS);
    $finish(0);
  end
endmodule
